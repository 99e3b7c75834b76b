m=vector(l,i,eval(Str("m",i)));h=vector(l,i,eval(Str("h",i)));X=vector(l,k,eval(Str("x",2*k-2)));
work()={
  my(x=vector(l),f=vector(l+1),n=1,total=0);
  x[1]=1;
  forstep(c=l,2,-1,for(k=1,n,f[k+1]+=x[k]*m[c]);n++;for(k=2,n,x[k]+=f[k]*h[c-1]));
  for(k=1,n,total+=x[k]*X[k]);
  total^3*k2;
}
number=Map();for(i=1,#names,mapput(number,eval(names[i]),i));
collect(p,e)={if(type(p)=="t_INT",if(p,listput(out,[p,e])),my(v=mapget(number,variable(p)),g=e);for(d=0,poldegree(p),g[v]=d;collect(polcoef(p,d),g)))};
listed()={out=List();collect(work(),vector(#names));out};
leaf(p,s)={if(type(p)=="t_INT",if(p,print(p,s)),my(v=variable(p));for(d=0,poldegree(p),leaf(polcoef(p,d),if(d,Str(s," ",v,"^",d),s))));}
least(f)={
  my(batch=1,times=List(),t,start);
  while(1,t=getabstime();for(i=1,batch,f());if(getabstime()-t>=20,break);batch*=2);
  start=getabstime();
  while(getabstime()-start<1000*seconds||#times<5,t=getabstime();for(i=1,batch,f());listput(times,(getabstime()-t)/batch));
  1000.*vecmin(Vec(times));
};
leaf(work(),"");
printf("%.3f %.3f\n",least(work),least(listed));
quit
